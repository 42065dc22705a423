"""The voice agent's tools: their table, and the rules by which the console's server carries out what a model calls."""
