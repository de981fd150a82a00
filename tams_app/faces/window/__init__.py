"""The operator's window: a process of its own that draws, and the application's side of it.

`messages` is what the two sides tell each other. Without a display can be tried: `banner`,
`figures`, `history`, `keyboard`, `pacing`, `places`. The others draw with GTK 4, in the process
alone, or are the application's side (`client`, `reports`).
"""
