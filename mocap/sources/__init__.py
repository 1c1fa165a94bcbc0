"""Where frames come from: one package or file a camera system, all behind `source.Source`."""
