"""The console's server: rosbridge protocol, rosapi, sessions with authority, and the page, behind one origin."""
