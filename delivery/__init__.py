"""What leaves the tool: exports of a calibrated or hybrid ship that run elsewhere."""
