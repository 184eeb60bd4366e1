% Processing of the report, in its original form: transforms, then a loop over cells.
%
% Requests and answers have the format of worker.py. Inputs are a MATLAB file of version 5.
1;

function mask = chain(x)
  if size(x.samples, 2) > 1, error("supports one channel only"), end
  cube = squeeze(x.samples);
  [n_chirps, n_samples] = size(cube);
  tr = double(x.n_training(2)); td = double(x.n_training(1));
  gr = double(x.n_guard(2)); gd = double(x.n_guard(1));
  hann_of = @(n) 0.5 - 0.5 * cos(2 * pi * (0:n - 1)' / n);
  cube = cube .* (hann_of(n_chirps) * hann_of(n_samples)');
  map = abs(fftshift(fft2(cube), 1)) .^ 2;
  n_cells = (2 * (tr + gr) + 1) * (2 * (td + gd) + 1) - (2 * gr + 1) * (2 * gd + 1);
  mask = false(size(map));
  for d = 1 + td + gd : n_chirps - td - gd
    for r = 1 + tr + gr : n_samples - tr - gr
      box = sum(sum(map(d - td - gd : d + td + gd, r - tr - gr : r + tr + gr)));
      guard = sum(sum(map(d - gd : d + gd, r - gr : r + gr)));
      mask(d, r) = map(d, r) > x.mean_factor * (box - guard) / n_cells;
    end
  end
end

x = []; mask = [];
while ischar(line = fgetl(stdin))
  if isempty(line), continue, end
  words = strsplit(line, "\t");
  try
    switch words{1}
      case "load"
        x = load(words{3});
        start = tic; mask = chain(x); spent = toc(start);
      case "turn"
        spent = Inf; turn_start = tic;
        do
          start = tic; mask = chain(x); spent = min(spent, toc(start));
        until toc(turn_start) > str2double(words{2})
      case "save"
        save("-v6", words{2}, "mask"); spent = 0;
    end
    printf("ok\t%.9g\n", spent);
  catch failure
    printf("no\t%s\n", strrep(failure.message, "\n", " "));
  end
  fflush(stdout);
end
