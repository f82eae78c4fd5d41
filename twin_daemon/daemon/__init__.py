"""The live twin without any transport: what arrives is validated, mirrored, predicted and compared."""
