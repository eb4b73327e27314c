"""What the ledger's claims are checked by: functions of the study's tables, one number of each counts."""
