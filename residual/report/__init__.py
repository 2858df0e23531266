"""Run folders, figures and report pages of trainings."""
