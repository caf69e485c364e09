// The convolutions of 16 pixels over a stretch of ticks, in registers.
//
// Order of every sum, for all instruction sets, chunks and blockings: start from the bias, inputs
// one after another, in each its taps from the oldest on, one std::fma a term. So an output does
// not depend on what is computed beside it.
//
// Included by kernel.inc inside a namespace of its own.

#if EVS_WIDTH == 512
EVS_INLINE Float fma(Float a, Float b, Float c) { return {_mm512_fmadd_ps(a.v, b.v, c.v)}; }
#elif EVS_WIDTH == 256
EVS_INLINE Float fma(Float a, Float b, Float c) {
  for (int i = 0; i < PARTS; i++) c.v[i] = _mm256_fmadd_ps(a.v[i], b.v[i], c.v[i]);
  return c;
}
#else
// slow where the compiler knows no such instruction: a call for each lane
EVS_INLINE Float fma(Float a, Float b, Float c) {
  for (int i = 0; i < PARTS; i++) {
    for (int j = 0; j < PART; j++) {
      c.v[i][j] = __builtin_fmaf(a.v[i][j], b.v[i][j], c.v[i][j]);
    }
  }
  return c;
}
#endif

// Outputs times ticks that are summed side by side; with less ticks left, outputs alone.
#if EVS_WIDTH == 512
constexpr int OUTPUTS = 4, TICKS = 4, OUTPUTS_ALONE = 8;
#else
constexpr int OUTPUTS = 2, TICKS = 2, OUTPUTS_ALONE = 4;
#endif

constexpr int SLOT = kLanes;
constexpr int FEATURE = kSlots * kLanes;

struct Convolving {
  const float* weights;  // (out, in, 7)
  const float* biases;   // (out,)
  int outputs;
  int inputs;
  const float* in;    // [in][22][16]; tap 0 of the first tick is in slot 0
  float* out;         // [out][22][16], from slot 6 on
  const float* held;  // [out][22][16] at the slot of the first tick; null: nothing is added
  int ticks;
};

// N outputs from `o` on, T ticks from `t` on. INPUTS: how many, 0 where only the network knows.
template <int INPUTS, int N, int T>
EVS_INLINE void patch(const Convolving& c, int o, int t) {
  const int inputs = INPUTS > 0 ? INPUTS : c.inputs;
  const int line = inputs * kTaps;
  const float* weights = c.weights + o * line;
  const float* in = c.in + t * SLOT;
  Float sum[N][T];
#pragma GCC unroll 8
  for (int n = 0; n < N; n++) {
#pragma GCC unroll 8
    for (int k = 0; k < T; k++) sum[n][k] = splat(c.biases[o + n]);
  }
  for (int i = 0; i < inputs; i++) {
#pragma GCC unroll 8
    for (int j = 0; j < kTaps; j++) {
      Float x[T];
#pragma GCC unroll 8
      for (int k = 0; k < T; k++) x[k] = load(in + (j + k) * SLOT);
#pragma GCC unroll 8
      for (int n = 0; n < N; n++) {
        const Float weight = splat(weights[n * line + j]);
#pragma GCC unroll 8
        for (int k = 0; k < T; k++) sum[n][k] = fma(weight, x[k], sum[n][k]);
      }
    }
    weights += kTaps;
    in += FEATURE;
  }
  const Float zero = splat(0.0f), largest = splat(kLargest);
#pragma GCC unroll 8
  for (int n = 0; n < N; n++) {
    float* out = c.out + (o + n) * FEATURE + (kOld + t) * SLOT;
#pragma GCC unroll 8
    for (int k = 0; k < T; k++) {
      Float value = sum[n][k];
      if (c.held != nullptr) value = load(c.held + (o + n) * FEATURE + (t + k) * SLOT) + value;
      store(out + k * SLOT, min(max(value, zero), largest));  // never -0, NaN or Inf
    }
  }
}

template <int INPUTS, int N>
EVS_INLINE void stripe(const Convolving& c, int o) {
  int t = 0;
  for (; t + TICKS <= c.ticks; t += TICKS) patch<INPUTS, N, TICKS>(c, o, t);
  for (; t < c.ticks; t++) patch<INPUTS, N, 1>(c, o, t);
}

template <int INPUTS>
[[gnu::noinline]] void convolve(const Convolving& c) {
  int o = 0;
  if (c.ticks < TICKS) {
    for (; o + OUTPUTS_ALONE <= c.outputs; o += OUTPUTS_ALONE) {
      for (int t = 0; t < c.ticks; t++) patch<INPUTS, OUTPUTS_ALONE, 1>(c, o, t);
    }
  }
  for (; o + OUTPUTS <= c.outputs; o += OUTPUTS) stripe<INPUTS, OUTPUTS>(c, o);
  for (; o < c.outputs; o++) stripe<INPUTS, 1>(c, o);
}

EVS_INLINE void convolve(const Convolving& c) {
  if (c.inputs == 1) return convolve<1>(c);
  if (c.inputs == 4) return convolve<4>(c);
  if (c.inputs == 8) return convolve<8>(c);
  convolve<0>(c);
}
