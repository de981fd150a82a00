"""Three H.264 streams over one uplink: `core` computes, `live` streams, `virtual` steps a clock."""
