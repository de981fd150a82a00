"""A session on two computers: `robot` beside the arm, `operator` where the person is.

Everything that can stop the arm is on the robot's side. The operator's side samples the controller,
shows the video and asks; it commands nothing. Between them: `tams_app.link`.
"""
