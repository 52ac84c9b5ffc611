"""One question per file. A file here is a suite: its first line asks, `run(full)` answers with a dict for JSON."""
