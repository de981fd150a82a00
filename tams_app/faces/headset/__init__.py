"""The views in the operator's headset: a process of its own that draws overlays of SteamVR.

It is a face of the session as the window is (`tams_app.faces.window`): the same facts, the same
frames, the same rules when it is gone. `layout` is pure, `painting` makes pixels, `texture` holds
them in a hidden OpenGL context, `display` does all of it step by step.
"""
