"""Finds what is physically wrong with a clip, repairs what can be, and joins clips."""
