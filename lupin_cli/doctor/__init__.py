"""The diagnosis of a laptop and its robots: gather facts, run checks, report findings, play fixes."""
