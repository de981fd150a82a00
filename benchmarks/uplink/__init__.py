"""How the budgets use an uplink: cases in the manner of RFC 8867."""
