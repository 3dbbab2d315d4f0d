"""The answer: effect files, JSON, words, pictures."""
