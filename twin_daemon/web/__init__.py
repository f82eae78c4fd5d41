"""The workbench: a page on which people see the hand and its twin, find what the model lacks, and keep what helps."""
