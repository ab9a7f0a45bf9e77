"""A scene as one HTML file, which a browser draws by itself, or as a widget in a notebook."""
