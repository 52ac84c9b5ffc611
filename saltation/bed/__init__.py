"""The bed: contact law, rebounds and roughness."""
