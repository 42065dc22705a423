"""The mission: explore, drive to every tag, read it, come home; a hierarchical state machine over navigation and the bridge."""
