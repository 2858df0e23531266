"""Damaged files and texts for every reader: only the project's own error may come out, soon and in one line.

python -m benchmarks.fuzz --inputs N --first S [--reader NAME ...] [--record]: inputs number S to S + N - 1 of each
reader; prints a table of counts and each unexpected outcome with the number by which it can be made again (``--inputs 1
--first THAT``).
"""
