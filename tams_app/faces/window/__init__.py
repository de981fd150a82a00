"""The operator's window: a process of its own that draws with GTK 4 (`process`).

Without a display can be tried: `keyboard`, `strips`, and of `tams_app.faces` what the window shares
with other faces: `banner`, `messages`, `shown`, `silence`, `views`.
"""
