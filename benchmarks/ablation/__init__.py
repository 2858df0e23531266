"""The judge: each mechanism switched off, one at a time, and measured on ground that it was not made on.

Run from the repository root: python -m benchmarks.ablation [fits] [diagnoses] [table] [--rows NAME ...]. A
switch is worth its lines where its row says that switching it off makes predictions worse by more than two standard
errors, or at least one in a hundred diagnoses of at least four worlds. What is measured is kept, by the state of the
product's code, in a record that grows line by line, so that a run which was stopped goes on.
"""
