"""OpenUSD with the words of UsdPhysics, as Isaac Sim and Newton write it; loops are joints like any other."""
