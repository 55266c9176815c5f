"""METHOD.md read literally, with no help from possmap: what the product is compared with."""
