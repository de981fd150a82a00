"""What every device keeps to: promises, each a function of a bench whose name says what is kept."""
