"""The digital twin: what is known of each tag, and fields interpolated between them."""
