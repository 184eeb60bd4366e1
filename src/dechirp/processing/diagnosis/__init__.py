"""Diagnosis of arrays that other programs computed: well-known mistakes and their evidence."""
