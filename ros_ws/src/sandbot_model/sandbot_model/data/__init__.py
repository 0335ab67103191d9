"""Trials gathered into cells, with their pure error: what every fit and every test is measured against."""
