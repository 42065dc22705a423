"""What the cameras see: tags and their places on the map, flowers and bugs in the boxes behind them."""
