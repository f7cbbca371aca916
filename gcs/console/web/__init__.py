"""The web server of the console: access, routes, orders and files."""
