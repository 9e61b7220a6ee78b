"""The files of a finished run: what evaluation writes and reporting reads."""
