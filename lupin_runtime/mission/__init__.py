"""The mission: explore, drive to every tag, read it, return to the dock. A state machine over navigation and the bridge."""
