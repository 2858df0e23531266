"""Raw logs of many formats, clocks and units, made canonical trial files (docs/how-to/import.md).

Constants of this room that name no source are set by hand; ``benchmarks.import_faults`` measures what they do together.
"""
