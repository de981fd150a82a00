"""Another distribution that adds one of each kind to TAMS, a module each."""
