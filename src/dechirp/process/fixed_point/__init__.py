"""The chain up to the detector in whole numbers of given word lengths, as a DSP or FPGA has it."""
