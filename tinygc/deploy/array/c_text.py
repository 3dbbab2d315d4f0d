"""The source of an array's C, tables left open."""

REGISTERS_PROTOTYPE = """
/* Registers gx gy gz of each unit as rates; all are present. */
void tinygc_array_from_registers(const int16_t registers[TINYGC_ARRAY_UNITS][3], tinygc_array_input *in);
"""

REGISTERS_TEXT = """
void tinygc_array_from_registers(const int16_t registers[TINYGC_ARRAY_UNITS][3], tinygc_array_input *in)
{
    for (int i = 0; i < N; i++) {
        for (int k = 0; k < 3; k++)
            in->rate[i][k] = (float)registers[i][k] * PER_LSB[i];
        in->present[i] = 1;
    }
}
"""

SOURCE_TEXT = """\
/* See {header}. */
#include "{header}"

#define N TINYGC_ARRAY_UNITS
{scalars}

{tables}

static const int16_t TEST_WHY[N] = {test_why};

static float square(float x)
{{
    return x * x;
}}

/* The weighted median of values[i] with weights[i], count of them, which it sorts. */
static float median(float values[N], float weights[N], int count)
{{
    float total = 0.0f, sum = 0.0f, end = 0.0f;
    for (int i = 1; i < count; i++)
        for (int j = i; j > 0 && values[j - 1] > values[j]; j--) {{
            const float v = values[j], w = weights[j];
            values[j] = values[j - 1];
            weights[j] = weights[j - 1];
            values[j - 1] = v;
            weights[j - 1] = w;
        }}
    for (int i = 0; i < count; i++)
        total += weights[i];
    for (int i = 0; i < count; i++) {{
        const float middle = sum + 0.5f * weights[i] - 0.5f * total, begin = middle - ALONE * weights[i];
        if (begin > 0.0f && i > 0)
            return end < 0.0f ? values[i - 1] - end / (begin - end) * (values[i] - values[i - 1]) : values[i - 1];
        end = middle + ALONE * weights[i];
        sum += weights[i];
    }}
    return values[count - 1];
}}

/* inverse of m; 0 where it has none */
static int invert(float m[3][3], float inverse[3][3])
{{
    float determinant = 0.0f;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {{
            const int a = (j + 1) % 3, b = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;
            inverse[i][j] = m[a][c] * m[b][d] - m[a][d] * m[b][c];
        }}
    for (int j = 0; j < 3; j++)
        determinant += m[0][j] * inverse[j][0];
    if (!(determinant > 1e-30f))
        return 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            inverse[i][j] /= determinant;
    return 1;
}}

static void fuse(float x[N][3], tinygc_array_output *out)
{{
    float weights[3][3] = {{{{0.0f}}}}, spread[3][3] = {{{{0.0f}}}}, inverse[3][3], sum[3] = {{0.0f}};
    for (int i = 0; i < N; i++) {{
        if (!out->used[i])
            continue;
        for (int r = 0; r < 3; r++)
            for (int c = 0; c < 3; c++) {{
                weights[r][c] += WEIGHT[i][r][c];
                spread[r][c] += SPREAD[i][r][c];
                sum[r] += WEIGHT[i][r][c] * x[i][c];
            }}
    }}
    out->valid = (uint8_t)invert(weights, inverse);
    for (int r = 0; r < 3; r++) {{
        out->rate[r] = out->variance[r] = 0.0f;
        if (!out->valid)
            continue;
        out->variance[r] = OWN[r];
        for (int c = 0; c < 3; c++) {{
            out->rate[r] += inverse[r][c] * sum[c];
            for (int k = 0; k < 3; k++)
                out->variance[r] += inverse[r][c] * spread[c][k] * inverse[r][k];
        }}
    }}
}}

void tinygc_array_start(tinygc_array_state *state)
{{
    for (int i = 0; i < N; i++) {{
        for (int k = 0; k < 3; k++)
            state->last[i][k] = state->mean[i][k] = 0.0f;
        state->allowed[i] = state->square[i] = 0.0f;
        state->missing[i] = state->same[i] = state->agreed[i] = 0;
        state->before[i] = state->why[i] = 0;
    }}
    for (int k = 0; k < 3; k++)
        state->middle[k] = 0.0f;
    state->step2 = 0.0f;
    state->begun = state->disagree = 0;
}}

static uint16_t longer(uint16_t count)
{{
    return (uint16_t)(count < 65535u ? count + 1u : count);
}}

void tinygc_array_step(tinygc_array_state *state, const tinygc_array_input *in, tinygc_array_output *out)
{{
    float x[N][3], apart[N][3], u[N], values[3][N], shares[3][N], middle[3], step2 = 0.0f, change2, allowed, size2 = 0.0f;
    uint8_t here[N], usable[N], known[N], believed[N];
    int candidates = 0, counted = 0, any = 0, there = 0, worst = -1, disagree = 0, agree = 1;

    for (int i = 0; i < N; i++) {{
        float rate[3];
        int same, end = 0;
        here[i] = in->present[i] != 0;
        for (int k = 0; k < 3; k++)
            here[i] = here[i] && in->rate[i][k] == in->rate[i][k]; /* not a number: no sample */
        for (int k = 0; k < 3; k++)
            rate[k] = here[i] ? in->rate[i][k] : 0.0f;
        same = here[i] && state->before[i];
        believed[i] = state->why[i] == 0;
        for (int k = 0; k < 3; k++) {{
            const float m = rate[k];
            same = same && m == state->last[i][k];
            end = end || m >= END_OF_RANGE[i] || m <= -END_OF_RANGE[i];
            x[i][k] = OFFSET[i][k];
            for (int c = 0; c < 3; c++)
                x[i][k] += MATRIX[i][k][c] * rate[c];
            state->last[i][k] = m;
        }}
        state->before[i] = here[i];
        state->same[i] = same && !end ? longer(state->same[i]) : 0;
        state->missing[i] = here[i] ? 0 : longer(state->missing[i]);
        usable[i] = here[i] && !end;
        if (usable[i] && believed[i]) {{
            for (int k = 0; k < 3; k++) {{
                values[k][candidates] = x[i][k];
                shares[k][candidates] = SHARE[i];
            }}
            candidates++;
        }}
    }}
    for (int k = 0; k < 3; k++) {{
        middle[k] = candidates ? median(values[k], shares[k], candidates) : state->middle[k];
        if (state->begun)
            step2 += square(middle[k] - state->middle[k]);
        size2 += square(middle[k]);
        state->middle[k] = middle[k];
    }}
    state->begun = state->begun || candidates;
    change2 = step2 > state->step2 ? step2 : state->step2;
    state->step2 = step2;
    allowed = SCALE2 * size2 + DELAY2 * change2;

    for (int i = 0; i < N; i++) {{
        known[i] = usable[i] && state->begun;
        u[i] = 0.0f;
        for (int k = 0; k < 3; k++) {{
            apart[i][k] = x[i][k] - middle[k];
            const float one = square(apart[i][k]) / (NOISE[i][k] + FIXED[i][k] + allowed);
            u[i] = one > u[i] ? one : u[i];
        }}
        counted += known[i] && believed[i];
    }}
    for (int i = 0; i < N; i++) {{
        out->used[i] = usable[i] && believed[i] && !(known[i] && u[i] > ASIDE2 && counted >= FEWEST);
        any += out->used[i];
    }}
    for (int i = 0; !any && i < N; i++)
        out->used[i] = usable[i] && believed[i];
    for (int i = 0; i < N; i++) {{
        there += here[i] && believed[i];
        any += out->used[i];
    }}
    out->at_end = !any && there;
    for (int i = 0; out->at_end && i < N; i++)
        out->used[i] = here[i] && believed[i];
    fuse(x, out);
    for (int k = 0; k < 3; k++) {{
        float most = 0.0f;
        for (int i = 0; state->disagree && i < N; i++)
            if (known[i] && believed[i] && square(apart[i][k]) > most)
                most = square(apart[i][k]);
        out->variance[k] = out->at_end ? 3e38f : out->variance[k] + most;
    }}

    out->changed = 0;
    for (int i = 0; i < N; i++) {{
        float slow = 0.0f;
        const int dead = state->missing[i] >= DEAD_AFTER, stuck = state->same[i] >= STUCK_AFTER;
        if (known[i]) {{
            const float shrink = u[i] > ASIDE2 ? ASIDE2 / u[i] : 1.0f;
            for (int k = 0; k < 3; k++)
                state->mean[i][k] += ALPHA * (apart[i][k] * shrink - state->mean[i][k]);
            state->allowed[i] += ALPHA * (allowed - state->allowed[i]);
            state->square[i] += ALPHA * ((u[i] > ASIDE2 ? ASIDE2 : u[i]) - state->square[i]);
        }}
        for (int k = 0; k < 3; k++) {{
            const float one = square(state->mean[i][k]) / (NOISE[i][k] * MEAN_SHARE + FIXED[i][k] + state->allowed[i]);
            slow = one > slow ? one : slow;
        }}
        slow /= SLOW2;
        out->score[i] = state->square[i] / FAST > slow ? state->square[i] / FAST : slow;
        if (known[i] || state->missing[i] >= DEAD_AFTER)
            state->agreed[i] = out->score[i] < BACK && !dead && !stuck && known[i] ? longer(state->agreed[i]) : 0;
        if (believed[i] && (dead || stuck)) {{
            state->why[i] = dead ? TINYGC_ARRAY_DEAD : TINYGC_ARRAY_STUCK;
            state->agreed[i] = 0;
            out->changed = 1;
        }} else if (!believed[i] && state->agreed[i] >= HOLD_FOR) {{
            state->why[i] = 0;
            state->agreed[i] = 0;
            out->changed = 1;
        }} else if (believed[i] && known[i] && out->score[i] > 1.0f) {{
            if (counted >= FEWEST && (worst < 0 || out->score[i] > out->score[worst]))
                worst = i;
        }}
        if (believed[i] && known[i] && out->score[i] > 1.0f)
            disagree = disagree || counted == FEWEST - 1;
        if (counted == FEWEST - 1 && believed[i] && !(out->score[i] < BACK))
            agree = 0;
    }}
    if (worst >= 0) {{
        state->why[worst] = state->same[worst] >= SOON_STUCK ? TINYGC_ARRAY_STUCK : TINYGC_ARRAY_DIFFERS;
        state->agreed[worst] = 0;
        out->changed = 1;
    }}
    if (state->disagree ? agree : disagree) {{
        state->disagree = !state->disagree;
        out->changed = 1;
    }}
    out->disagree = state->disagree;
    for (int i = 0; i < N; i++)
        out->why[i] = state->why[i];
}}
{registers}
int tinygc_array_self_test(float *worst)
{{
    tinygc_array_state state;
    tinygc_array_input in;
    tinygc_array_output out;
    int failed = 0;
    *worst = 0.0f;
    tinygc_array_start(&state);
    for (int n = 0; n < TEST_COUNT; n++) {{
        for (int i = 0; i < N; i++) {{
            for (int k = 0; k < 3; k++)
                in.rate[i][k] = TEST_INPUTS[n][i][k];
            in.present[i] = 1;
        }}
        tinygc_array_step(&state, &in, &out);
        for (int k = 0; k < 3; k++) {{
            const float expected = TEST_RATES[n][k];
            const float size = expected < 0.0f ? -expected : expected;
            float off = out.rate[k] - expected;
            off = off < 0.0f ? -off : off;
            if (!(off <= *worst))
                *worst = off;
            if (!(off <= {tolerance} * (1.0f + size)) && !failed)
                failed = n + 1;
        }}
    }}
    for (int i = 0; i < N; i++)
        if (out.why[i] != TEST_WHY[i] && !failed)
            failed = TEST_COUNT;
    return failed;
}}
"""
