"""All views under one virtual clock: real encoders, jitter buffers and decoders, event by event."""
