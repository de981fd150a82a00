"""Pages and figures of a session, made from its log."""
