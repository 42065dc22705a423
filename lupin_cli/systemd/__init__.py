"""The robot's systemd unit files, rendered from templates."""
