"""The session in a browser: a server for one page, and the loop that plays."""
