
int SHIP_step_many(const SHIP_model *model, int count, real *states, const real *inputs, double h) {
  int i, failed = 0;
  for (i = 0; i < count; i++) failed += SHIP_step(model, states + (size_t)i * @S@, inputs + (size_t)i * @C@, h);
  return failed;
}
