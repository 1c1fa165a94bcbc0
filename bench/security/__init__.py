"""What a lab with keys costs, and what it withstands, by real sockets on loopback."""
