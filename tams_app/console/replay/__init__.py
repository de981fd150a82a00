"""`replay`: a session's log through the console that showed the session."""
