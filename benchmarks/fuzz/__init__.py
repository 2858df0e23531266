"""Damaged files and texts for every reader: only the project's own error may come out, soon and in one line.

python -m benchmarks.fuzz --inputs N --first S [--reader NAME ...] [--record]: inputs number S to S + N - 1 of each
reader (``samples/logs`` holds a good raw log of each format, and its map); prints each unexpected outcome with the
number by which it can be made again (``--inputs 1 --first THAT``), and their count.
"""
