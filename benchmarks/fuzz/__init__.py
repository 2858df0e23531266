"""Damaged files and texts for every reader: only the project's own error may come out, soon and in one line.

python -m benchmarks.fuzz --inputs N --first S [--logs] [--reader NAME ...] [--record]: inputs number S to S + N - 1 of
each reader, or of those of raw logs alone (``samples/logs`` holds a good one of each format, and its map); prints a
table of counts and each unexpected outcome with the number by which it can be made again (``--inputs 1 --first THAT``).
"""
