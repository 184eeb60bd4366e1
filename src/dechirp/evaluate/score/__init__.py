"""Scores of trials: a family. A file is a member, its name the word for it in study files."""
