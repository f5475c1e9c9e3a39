"""Missions: their files, the runner, the ledger, what is recorded, results and reports."""
