"""Perception by camera: tags and their poses in the map, flowers and bugs in the boxes behind them."""
