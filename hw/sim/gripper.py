"""Size and shape of the rig's two-finger gripper: drawn by the scene, known to the operator.

In the flange's frame [m]: z points down when the gripper does, the fingers close along y.
"""

from __future__ import annotations

TCP_OFFSET_M = 0.082  # from the flange along its z
FINGER_TRAVEL_M = 0.008  # each; 16 mm between the pads when open

# Centre and half size.
HOUSING = ((0.0, 0.0, 0.027), (0.018, 0.034, 0.021))
PLATE = ((0.0, 0.0, 0.050), (0.0125, 0.032, 0.003))

# Half sizes: of each finger the green pad and the dark clip behind it; of the housing's markers,
# whose edge includes the quiet zone.
PAD_HALF = (0.0065, 0.0040, 0.011)
CLIP_HALF = (0.0068, 0.0012, 0.006)
MARKER_HALF_M = 0.0165
