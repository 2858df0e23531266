"""Where the sim-to-real gap lies, which effect causes it, and how far it closes on trials that took no part."""
