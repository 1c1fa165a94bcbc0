"""VRPN, and Chingmu's cameras, which speak it in a manner of their own: messages, assembly of frames, client."""
