"""The operator's displays and answers; what all faces share, and each of them."""
