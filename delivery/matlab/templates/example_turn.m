% A turn of 600 s in steps of 0.1 s; compiled where SHIP_mex has been built (see README.md).
p = SHIP();
ship = @SHIP;
if exist('SHIP_mex', 'file') == 3
  ship = @SHIP_mex;
end
inputs = zeros({{ C }}, 1);
{{ SETTINGS }}state = ship('settle', [0; 0; 0; {{ SPEED }}; 0; 0], inputs, p);
motion = zeros(6001, 6);
for k = 1:6001
  motion(k, :) = state(1:6);
{{ CLOCK }}  state = ship('step', state, inputs, 0.1, p);
end
fprintf('after 600 s: x %.3f m, y %.3f m, heading %.1f deg, speed %.3f m/s, extrapolation %.2f\n', motion(end, 1), ...
  motion(end, 2), motion(end, 3) * 180 / pi, hypot(motion(end, 4), motion(end, 5)), ...
  ship('extrapolation', state, inputs, p));
