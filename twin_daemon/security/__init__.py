"""Who somebody is: identities and their proofs, certificates and who issues them."""
