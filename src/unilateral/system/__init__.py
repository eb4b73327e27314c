"""What the computer gives: files and their formats, memory, and signals from outside."""
