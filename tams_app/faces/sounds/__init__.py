"""The sounds of a session: a tone when the arm holds, at a fault, and when it is ready again."""
