"""The view weight matrix W from people's ratings of clips, one phase at a time (paper, III-C)."""
