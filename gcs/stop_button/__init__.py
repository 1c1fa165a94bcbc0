"""The stop button: any key or button of a Linux input device, read by the ground itself."""
