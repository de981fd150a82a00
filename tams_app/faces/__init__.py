"""What the operator looks at and answers with; what all faces share, and each of them."""
