"""The calibrated ship as a torch operator with exact derivatives."""
