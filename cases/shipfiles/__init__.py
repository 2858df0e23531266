"""Ship files: read, write, new ships from main particulars, effects and networks of a ship."""
