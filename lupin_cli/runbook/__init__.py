"""Playbooks: validated YAML over operations, with dry run, journal, resume and rollback."""
