"""Output for users: terminal tables, HTML reports and pictures."""
