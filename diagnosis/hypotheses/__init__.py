"""Which effect is missing: score tests, forward selection, refits, unnamed forces, next test."""
