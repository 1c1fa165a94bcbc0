"""The lab's keys: making, packing, installing, checking, replacing and revoking them."""
