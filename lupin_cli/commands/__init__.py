"""One module per verb: a plain verb is a function `command`, a verb with subcommands is a Typer called `app`."""
