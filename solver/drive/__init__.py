"""One GPS car along kilometers of fiber: which channel lies where along the operator's map."""
