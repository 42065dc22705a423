"""The console: a server that offers browsers and other programs the graph through rosbridge, rosapi, an API and a page."""
