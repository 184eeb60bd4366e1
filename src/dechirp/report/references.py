"""What the paper cites, by key; the dashes of page numbers come with the page."""

REFERENCES = {
    "stove": "A. G. Stove, “Linear FMCW radar techniques,” IEE Proceedings F, vol. 139, no. 5,"
    " pp. 343-350, 1992.",
    "griffiths": "H. D. Griffiths, “New ideas in FM radar,” Electronics & Communication"
    " Engineering Journal, vol. 2, no. 5, pp. 185-194, 1990.",
    "rohling-meinecke": "H. Rohling and M.-M. Meinecke, “Waveform design principles for"
    " automotive radar systems,” in Proc. CIE International Conference on Radar, Beijing,"
    " pp. 1-4, 2001.",
    "winkler": "V. Winkler, “Range Doppler detection for automotive FMCW radars,” in Proc."
    " European Radar Conference, Munich, pp. 166-169, 2007.",
    "marcum": "J. I. Marcum, “A statistical theory of target detection by pulsed radar,” IRE"
    " Transactions on Information Theory, vol. 6, no. 2, pp. 59-267, 1960.",
    "swerling": "P. Swerling, “Probability of detection for fluctuating targets,” IRE"
    " Transactions on Information Theory, vol. 6, no. 2, pp. 269-308, 1960.",
    "finn-johnson": "H. M. Finn and R. S. Johnson, “Adaptive detection mode with threshold"
    " control as a function of spatially sampled clutter-level estimates,” RCA Review, vol. 29,"
    " no. 3, pp. 414-464, 1968.",
    "gandhi-kassam": "P. P. Gandhi and S. A. Kassam, “Analysis of CFAR processors in"
    " nonhomogeneous background,” IEEE Transactions on Aerospace and Electronic Systems,"
    " vol. 24, no. 4, pp. 427-445, 1988.",
    "rohling": "H. Rohling, “Radar CFAR thresholding in clutter and multiple target"
    " situations,” IEEE Transactions on Aerospace and Electronic Systems, vol. 19, no. 4,"
    " pp. 608-621, 1983.",
    "rife-boorstyn": "D. C. Rife and R. R. Boorstyn, “Single-tone parameter estimation from"
    " discrete-time observations,” IEEE Transactions on Information Theory, vol. 20, no. 5,"
    " pp. 591-598, 1974.",
    "kay": "S. M. Kay, Fundamentals of Statistical Signal Processing, vol. I: Estimation"
    " Theory. Prentice Hall, 1993.",
    "harris": "F. J. Harris, “On the use of windows for harmonic analysis with the discrete"
    " Fourier transform,” Proceedings of the IEEE, vol. 66, no. 1, pp. 51-83, 1978.",
    "clopper-pearson": "C. J. Clopper and E. S. Pearson, “The use of confidence or fiducial"
    " limits illustrated in the case of the binomial,” Biometrika, vol. 26, no. 4, pp. 404-413,"
    " 1934.",
    "richards": "M. A. Richards, Fundamentals of Radar Signal Processing, 2nd ed. McGraw-Hill,"
    " 2014.",
    "li-stoica": "J. Li and P. Stoica, “Efficient mixed-spectrum estimation with applications"
    " to target feature extraction,” IEEE Transactions on Signal Processing, vol. 44, no. 2,"
    " pp. 281-295, 1996.",
}
