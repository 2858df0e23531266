function varargout = SHIP(what, varargin)
% The ship SHIP, SI units and radians, for MATLAB and Octave.
%
%   p = SHIP()                                  struct of parameters: p.coefficients.NAME.value, .std (NaN: not
%                                               known), .unit, .lower, .upper, .verdict; names, units, ranges
%   rates = SHIP('rates', state, inputs, p)     d state / dt, {{ S }} x 1
%   forces = SHIP('forces', state, inputs, p)   X, Y [N], N [N m] of each role of p.roles, {{ R }} x 3
%   columns = SHIP('columns', state, p)         x, y, psi, u, v, r as the instruments log them, 6 x 1
%   state = SHIP('settle', columns, inputs, p)  the state behind logged columns, its memory settled
%   state = SHIP('step', state, inputs, h, p)   the state h seconds later, inputs held
%   e = SHIP('extrapolation', state, inputs, p) 0 inside what the trials held, else the largest distance outside over
%                                               the width of that range; -1 where no range is known
%
% state: {{ STATES }}
% inputs: {{ INPUTS }}
% Without p the ship has its own parameters. SHIP_mex.c does the same as compiled code.
%
{{ ABOUT }}
  if nargin == 0
    varargout{1} = parameters();
    return
  end
  known = struct('rates', 2, 'forces', 2, 'columns', 1, 'settle', 2, 'step', 3, 'extrapolation', 2);
  if ~ischar(what) || ~isfield(known, what)
    error('SHIP:what', 'ask for rates, forces, columns, settle, step or extrapolation');
  end
  count = known.(what);
  if numel(varargin) < count || numel(varargin) > count + 1
    error('SHIP:arguments', '%s takes %d arguments and the parameters; see help SHIP', what, count);
  end
  if numel(varargin) > count
    p = varargin{end};
  else
    p = parameters();
  end
  rows = struct2cell(p.coefficients);
  rows = [rows{:}];
  theta = [rows.value].';
  first = {{ S }};
  if strcmp(what, 'settle')
    first = 6;
  end
  if numel(varargin{1}) ~= first
    error('SHIP:size', '%s needs %d numbers first', what, first);
  end
  state = varargin{1}(:);
  if count > 1
    inputs = varargin{2}(:);
    if numel(inputs) ~= {{ C }}
      error('SHIP:size', 'there are {{ C }} inputs: {{ INPUTS }}');
    end
  end
  switch what
    case 'rates'
      varargout{1} = rates_of(state, inputs, theta);
    case 'forces'
      varargout{1} = forces_of(state, inputs, theta);
    case 'columns'
      varargout{1} = columns_of(state, theta);
    case 'settle'
      varargout{1} = settle(state, inputs, theta);
    case 'step'
      varargout{1} = step(state, inputs, varargin{3}, theta);
    case 'extrapolation'
      varargout{1} = extrapolation(state, inputs, theta);
  end
end

function state = step(state, inputs, h, theta)
  if ~isscalar(h) || ~(h >= 0) || isinf(h)
    error('SHIP:step', 'h must be a number of seconds, 0 or more');
  end
  steps = max(1, ceil(h / {{ LONGEST_STEP }} - 1e-9));
  h = h / steps;
  for k = 1:steps
    k1 = rates_of(state, inputs, theta);
    k2 = rates_of(state + 0.5 * h * k1, inputs, theta);
    k3 = rates_of(state + 0.5 * h * k2, inputs, theta);
    k4 = rates_of(state + h * k3, inputs, theta);
    state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
  end
end
{% for head, lines in FUNCTIONS %}

function {{ head }}
{% for line in lines %}
  {{ line }}
{% endfor %}
end
{% endfor %}
{% if MEMBERS %}

function added = network(features)
  persistent c
  if isempty(c)
    c = weights_of_network();
  end
  x = features([{{ PLACES | join(", ") }}]) ./ c.features;
  total = zeros(3, 1);
{% for depth in MEMBERS %}
{% set k = loop.index %}
  h = x;
{% for i in range(1, depth + 1) %}
  h = tanh(c.W{{ k }}_{{ i }} * h + c.b{{ k }}_{{ i }}) - tanh(c.b{{ k }}_{{ i }});
{% endfor %}
  total = total + c.W{{ k }} * h;
{% endfor %}
  added = c.outputs .* total / {{ MEMBERS | length }};
end

function c = weights_of_network()
{% for line in WEIGHTS %}
  {{ line }}
{% endfor %}
end
{% endif %}

function state = settle(logged, inputs, theta)
  six = logged;
  state = settled(six, inputs, theta);
{% if MEASURED %}
  for k = 1:{{ INVERSIONS }}
    difference = columns_of(state, theta) - logged;
    six = six - difference;
    state = settled(six, inputs, theta);
    if ~(max(abs(difference)) > 1e-12)
      break
    end
  end
{% endif %}
end

function e = extrapolation(state, inputs, theta)
{% if RANGES %}
  if ~all(isfinite(state))
    e = realmax;
    return
  end
  f = features_of(state, inputs, theta);
  x = zeros({{ RANGES | length }}, 1);
{% for name, (low, high) in RANGES.items() %}
{% if name in FEATURE %}
  x({{ loop.index }}) = f({{ FEATURE[name] }});
{% else %}
  x({{ loop.index }}) = {{ number(0.5 * (low + high)) }};
  if f({{ FEATURE.u }})^2 + f({{ FEATURE.v }})^2 > {{ SLOW }}
    x({{ loop.index }}) = atan2(-f({{ FEATURE.v }}), f({{ FEATURE.u }}));
  end
{% endif %}
{% endfor %}
  {{ LOW }}
  {{ HIGH }}
  width = max(max(high - low, 0.1 * max(abs(low), abs(high))), 1e-12);
  e = max(max(max(x - high, low - x), 0) ./ width);
{% else %}
  e = -1;
{% endif %}
end

function p = parameters()
  p.ship = {{ text(NAME) }};
  p.title = {{ text(TITLE) }};
  p.about = {{ text(SENTENCES) }};
{% for field, names in NAMED.items() %}
  p.{{ field }} = { {{- names -}} };
{% endfor %}
  p.longest_step = {{ LONGEST_STEP }};
  p.ranges = struct();
{% for name, (low, high) in RANGES.items() %}
  p.ranges.{{ name }} = [{{ number(low) }}, {{ number(high) }}];
{% endfor %}
{% for c in COEFFICIENTS %}
  p.coefficients.{{ c.identifier }} = struct('value', {{ number(c.value) }}, 'std', {{ number(c.std) }}, 'unit', {{ text(c.unit) }}, 'lower', {{ number(c.lower) }}, 'upper', {{ number(c.upper) }}, 'fixed', {{ c.fixed | lower }}, 'verdict', {{ text(c.verdict) }}, 'description', {{ text(c.description) }}, 'symbol', {{ text(c.symbol) }});
{% endfor %}
end
{{ WHEN }}