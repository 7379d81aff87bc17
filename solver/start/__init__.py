"""Where a fit begins: the matched filter and the rough routes that follow from it."""
