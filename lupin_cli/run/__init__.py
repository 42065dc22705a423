"""Following a run from the terminal: live view, mission requests, summary, recordings."""
