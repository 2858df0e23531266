"""Reading trial files: tables, headers, units, conventions, sidecars and site files."""
