"""Damaged files and texts for every reader: only the project's own error may come out, soon and in one line.

python -m benchmarks.fuzz --inputs N --first S [--reader NAME ...] [--log FILE]: inputs number S to S + N - 1 of each
reader; prints a table of counts and each unexpected outcome with the number by which it can be made again (``--inputs 1
--first THAT``). --log: a line of JSON for each piece is added to FILE; --table FILE adds them up.
python -m benchmarks.fuzz.guided READER [options of libFuzzer]: the same readers under atheris, guided by coverage.
"""
