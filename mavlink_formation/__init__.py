"""What runs inside other people's processes: it imports none of our packages, whose names may be theirs as well."""
