"""The whole stack on somebody else's physics: rotorpy's AscTec Hummingbird (optional extra `rotorpy`)."""
