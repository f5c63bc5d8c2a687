"""Pictures and films: pixels exist only here."""
