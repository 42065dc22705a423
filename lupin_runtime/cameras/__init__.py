"""The cameras' pictures as video for browsers: JPEG frames over HTTP."""
