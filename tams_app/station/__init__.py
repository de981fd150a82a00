"""The operator's side of a session: it samples the controller, shows the video, and asks."""
