"""Raw logs as people have them, of many formats, clocks and units, into canonical trial files (docs/import.md)."""
