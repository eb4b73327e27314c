"""Certificates: files from which `certificate/check.py` proves an error bound without this package."""
