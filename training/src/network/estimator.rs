//! Trunks and heads of a variant together: what a finished training leaves.

use super::architecture::Architecture;
use super::head::{self, Head};
use super::trunk::{self, Trunk};
use super::weights::Initialiser;
use crate::labels::{BINS, PARAMETERS};
use crate::variant::{HeadPlan, Variant};
use burn::module::Module;
use burn::tensor::activation::softmax;
use burn::tensor::{Device, Tensor};

/// Networks of one variant. PyTorch's names of the weights follow from these: `trunk0.conv1.weight`,
/// `heads.0.fc1.bias`.
#[derive(Module, Debug)]
pub struct Estimator {
    /// CNN_0's, if the variant has it.
    pub trunk0: Option<Trunk>,
    /// CNN_w's, if the variant has it.
    pub trunkw: Option<Trunk>,
    /// One a block; one in all for variants without.
    pub heads: Vec<Head>,
}

impl Estimator {
    /// With first weights.
    pub fn new(variant: Variant, architecture: Architecture, seed: u64, device: &Device) -> Self {
        let trunks = [0, 1].map(|which| {
            let first = which * trunk::LAYERS;
            let mut layers = Initialiser::new(seed, first, device);
            variant.trunks()[which as usize].then(|| Trunk::new(architecture, &mut layers))
        });
        let plans = variant.heads();
        let heads = plans
            .iter()
            .enumerate()
            .map(|(number, plan)| new_head(plan, number, architecture, seed, device));
        let heads = heads.collect();
        let [trunk0, trunkw] = trunks;
        Self {
            trunk0,
            trunkw,
            heads,
        }
    }

    /// The logits of all parameters, (batch, 10, 100), of photographs as CNN_0 and as CNN_w read
    /// them, each (batch, 6, side, side). Photographs that the variant does not read may be missing.
    ///
    /// # Panics
    ///
    /// When photographs are missing that the variant reads.
    pub fn logits(&self, variant: Variant, photographs: [Option<Tensor<4>>; 2]) -> Tensor<3> {
        let [zero, whitened] = photographs;
        let features = [(&self.trunk0, zero), (&self.trunkw, whitened)].map(|(trunk, pixels)| {
            let pair = trunk.as_ref().zip(pixels);
            pair.map(|(trunk, pixels)| trunk.forward(pixels, None))
        });
        let mut logits: Vec<Option<Tensor<3>>> = vec![None; PARAMETERS];
        for (plan, head) in variant.heads().iter().zip(&self.heads) {
            let mut inputs: Vec<Tensor<2>> = Vec::new();
            for (wanted, found) in plan.features.into_iter().zip(&features) {
                match found {
                    Some(found) if wanted => inputs.push(found.clone()),
                    None if wanted => panic!("the variant reads photographs that are missing"),
                    _ => {}
                }
            }
            for &parameter in &plan.given {
                let Some(known) = &logits[parameter] else {
                    unreachable!("heads come after those that they are told by");
                };
                inputs.push(softmax(known.clone(), 2).flatten(1, 2));
            }
            let found = head.forward(Tensor::cat(inputs, 1), None);
            let [batch, _] = found.dims();
            let found = found.reshape([batch, plan.outputs.len(), BINS]);
            for (place, &parameter) in plan.outputs.iter().enumerate() {
                logits[parameter] = Some(found.clone().narrow(1, place, 1));
            }
        }
        Tensor::cat(logits.into_iter().flatten().collect(), 1)
    }
}

/// The head of block `number` of a variant, with its first weights.
pub(crate) fn new_head(
    plan: &HeadPlan,
    number: usize,
    architecture: Architecture,
    seed: u64,
    device: &Device,
) -> Head {
    // Behind both trunks and the heads before it.
    let first = 2 * trunk::LAYERS + number as u64 * head::LAYERS;
    let inputs = plan.inputs(&architecture);
    let mut layers = Initialiser::new(seed, first, device);
    Head::new(architecture, inputs, plan.outputs.len(), &mut layers)
}
