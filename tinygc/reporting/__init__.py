"""Results for people: the terminal's tables, the HTML report, pictures."""
