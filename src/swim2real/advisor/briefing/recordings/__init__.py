"""Recordings and their playbacks, as a VLM is told and shown them."""
