"""Commands that measure: `grape reproduce` (a row of what is asked for) and `grape bench` (speed beside a peer)."""
