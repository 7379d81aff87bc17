"""The report of a run: figures, words, and one page that opens offline."""
