"""Raw logs of many formats, clocks and units, made canonical trial files (docs/how-to/import.md)."""
