"""Session logs as a LeRobotDataset v3.0: one episode a log, on a grid of constant frame rate."""
