"""Blind benchmark of the gap diagnosis: cases are generated and their key is sealed, then solved, then scored."""
