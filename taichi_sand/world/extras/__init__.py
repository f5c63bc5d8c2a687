"""What only some scenes need: columns of effects, links, the hand, the ledger of energy, wetness, steady forces."""
