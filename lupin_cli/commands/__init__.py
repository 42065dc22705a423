"""One module per verb: a plain verb is a function `command`, a verb with verbs of its own is a Typer called `app`."""
